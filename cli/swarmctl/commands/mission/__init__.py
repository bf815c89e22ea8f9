"""The commands of `mission`: check, start and abort missions, and follow their members."""
