"""Films: scenes of characters, takes, sounds and cameras, as videos or as one animated .glb."""
