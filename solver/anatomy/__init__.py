"""What a character's shape says of its limbs: its ends, its curve skeleton, its orientation."""
