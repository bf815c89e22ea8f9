"""Who may take part: the roster, sessions, signatures, rights to a path, and the rate of datagrams."""
