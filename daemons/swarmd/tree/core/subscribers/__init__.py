"""Platforms that subscribe here: their leases, what each is owed, resources watched for them."""
