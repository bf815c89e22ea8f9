"""The version of this installation, below all that records or shows it."""

__version__ = "0.1.0"
