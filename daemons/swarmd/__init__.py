"""The daemons: one folder each; `core.py` decides, `service.py` does. A daemon never imports a daemon."""
