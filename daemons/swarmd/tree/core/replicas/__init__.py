"""State for other platforms: their structures, the subscriptions to them, their notifications."""
