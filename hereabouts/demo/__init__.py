"""The demo: a simulated robot maps the demo house, then searches it."""
