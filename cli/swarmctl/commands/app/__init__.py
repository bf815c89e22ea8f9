"""The commands of `app`: the applications that run on the nodes, from their registers."""
