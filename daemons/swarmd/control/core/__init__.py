"""The decisions of control: the table of modes, and the core that applies it."""
