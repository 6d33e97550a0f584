"""What screens and phones of visitors get: characters, branding, films and their addresses."""
