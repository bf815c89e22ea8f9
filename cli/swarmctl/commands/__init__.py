"""Commands, a file each: read the options, make one call, print. No logic of their own."""
