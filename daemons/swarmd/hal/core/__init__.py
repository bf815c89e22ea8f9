"""Pure parts of the hardware abstraction: schedules and their figures, filters, packet timing."""
