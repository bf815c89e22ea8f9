"""All neighbours of this node: who is due or silent, and by which medium and address each is reached."""
