"""One value of a resource: its quality, its rate, and its conversion from text."""
