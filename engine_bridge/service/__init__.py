"""The live service: stages and the players of characters, and the loop that runs them."""
