"""Exchange with other nodes: beacons and frames, over the connections and datagrams of `sockets`."""
