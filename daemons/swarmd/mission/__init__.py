"""Mission daemon: takes orders, checks them, plays them with the ensemble, reports.

May live here: cores that decide (`core/`), the functional blocks (`blocks/`), the shell. Not here: what a
mission is and whether it is sound (`swarmware.mission`).
"""
