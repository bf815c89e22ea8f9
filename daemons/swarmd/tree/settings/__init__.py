"""Live settings and notification rules, with the files that keep them over restarts."""
