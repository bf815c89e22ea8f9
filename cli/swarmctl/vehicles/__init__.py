"""Vehicles as a command addresses them: selection and its options, their observation, built-in missions.

Shared by `hold`, `land`, `return`, `arm`, `disarm`, `kill` and `mission abort`.
"""
