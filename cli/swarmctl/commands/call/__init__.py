"""The command `call`: sends a request or a message to a command of the tree and prints the answer."""
