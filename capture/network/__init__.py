"""Skeletons from senders in the network: OSC in its dialects."""
