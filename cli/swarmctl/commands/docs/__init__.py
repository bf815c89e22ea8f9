"""The command `docs`: where the documentation of this installation is, and a browser with it."""
