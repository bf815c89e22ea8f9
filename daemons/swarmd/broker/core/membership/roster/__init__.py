"""Exchange of the roster between neighbours: versions, differences of two rosters, and their requests."""
