"""The commands arm, disarm and kill."""
