"""Platforms that subscribe here: their leases, their pending values, resources watched for them."""
