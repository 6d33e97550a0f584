"""Pictures: of characters, of puppets, and of what a sensor sees."""
