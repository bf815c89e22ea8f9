"""Media below the broker: by what datagrams travel, and how many of them arrive over each."""
