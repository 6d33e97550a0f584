"""The puppet file: its model, its editing, and a first proposal for any mesh."""
