"""The operator's hand: a file under `commands/` is a command (group); slow imports come late."""
