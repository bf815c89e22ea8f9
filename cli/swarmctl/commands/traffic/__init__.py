"""Commands of `traffic`: counters of a broker, rates of channels, and their limits."""
