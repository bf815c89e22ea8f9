"""The reference functional module: where it is, where it should be, how to get there unhurt."""
