"""Flight control without I/O: filters of attitude and motion, the loops of the cascade, the mixer."""
