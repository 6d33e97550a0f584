"""The control socket and the requests that it accepts."""
