"""arm, disarm and kill."""
