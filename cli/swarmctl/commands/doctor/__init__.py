"""The command `doctor`: checks of this machine and of its node, each with an advice."""
