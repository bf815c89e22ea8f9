"""Clock conversions."""
