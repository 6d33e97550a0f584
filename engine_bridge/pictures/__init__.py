"""Images of characters, puppet files, clips and sources."""
