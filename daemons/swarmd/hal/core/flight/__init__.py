"""Flight control without I/O: filters of attitude and motion, control loops in cascade, and the mixer."""
