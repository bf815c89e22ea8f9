"""The logger: what moves in a node is written to a local ring and forwarded to MongoDB."""
