"""Everything a user touches: puppet files, performances, glTF and the command line."""
