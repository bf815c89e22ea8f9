"""Extra parts of a beacon that need no other part: signature, proof, media, structures, session checks."""
