"""Mission daemon: accepts orders, checks them, plays them with the ensemble, reports.

Belongs here: cores that decide (`core/`), the functional blocks (`blocks/`), the shell. Not here: the model
of a mission and its check (`swarmware.mission`).
"""
