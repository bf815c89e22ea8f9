"""Notifications of values between trees: when one is due, numbering, repetition, order at the receiver."""
