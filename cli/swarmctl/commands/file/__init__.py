"""Files of nodes: blocks are sent and fetched by a window, a list is printed."""
