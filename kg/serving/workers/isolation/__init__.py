"""Isolation of a worker by the kernel: its system calls, files, network and privileges."""
