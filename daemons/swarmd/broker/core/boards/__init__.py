"""Board values in beacons: those of this platform that are due, those of others to relay, rate limits."""
