"""What a URI opens: the registry of sources, and recordings played again."""
