"""The command `pub`: publishes values as a board, event or stream that the command itself owns."""
