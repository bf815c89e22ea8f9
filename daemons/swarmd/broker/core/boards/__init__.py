"""Board values in beacons: due values of this platform, relayed values of others, and rate limits."""
