"""Untrusted queries, evaluated in processes that can be killed.

Oxigraph cannot cancel a query, so `kg.serving.workers.pool.QueryPool` has worker processes evaluate
them on snapshots of the map, under limits of time, memory and size that the kernel and the pool
enforce.
"""
