"""What the monitor decides: faults and their life, checks of modules, rules of its own. No sockets."""
