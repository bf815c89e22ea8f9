"""Application register: the preferred master of this computer, and what the masters of others tell."""
