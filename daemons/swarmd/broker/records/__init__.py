"""Records that outlive a moment: the roster, the former session, outages, forgeries, served metrics."""
