"""The registry of source URIs, and the sources that play recordings and example motions."""
