"""The puppet file: its contents, editing, and proposals for any mesh."""
