"""The live service: stages, the wire protocol, the control socket and what keeps it running."""
