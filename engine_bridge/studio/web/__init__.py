"""The studio's web server: the page, the API, the stream, and who may use them."""
