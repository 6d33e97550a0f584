"""glTF: characters in, animations out."""
