"""Media below the broker: by what datagrams travel to each neighbour, how good that is, and which is used."""
