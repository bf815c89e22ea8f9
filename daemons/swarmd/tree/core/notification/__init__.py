"""Notifications of values between trees: conditions, serials, retransmission, order at the receiver."""
