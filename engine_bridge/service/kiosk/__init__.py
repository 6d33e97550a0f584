"""A kiosk: visitors record themselves by a gesture, see what they did, and get it as a film for some minutes."""
