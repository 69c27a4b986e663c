"""Maps opened, served over HTTP, published and edited."""
