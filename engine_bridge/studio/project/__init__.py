"""The project on disk: uploads, characters, takes and exports."""
