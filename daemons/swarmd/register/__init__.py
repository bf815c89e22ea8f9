"""Application register: the preferred master of this computer, and the tables of other masters."""
