"""Hardware abstraction layer: drivers publish devices as resources, each at its own rate (S2.2, S2.5)."""
