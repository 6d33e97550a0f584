"""Everything a user touches: puppet files, characters, performances, exports, the service and the command line."""
