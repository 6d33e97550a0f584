"""A performer's frames become a character's controls, live and offline alike."""
