"""The other platforms as seen from here: their structures, the subscriptions there, what comes of them."""
