"""The command `wait`: returns when a condition on the values of resources holds."""
