"""Reports of the broker: tables of neighbours and routes, outages, refused input, and the metrics page."""
