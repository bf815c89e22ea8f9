"""A link by itself: its states and cost, and the questions that find its silence early."""
