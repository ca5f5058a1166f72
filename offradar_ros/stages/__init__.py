"""The pipeline of a scan: encode, map, query.

The live nodes, the replay and the command line all run these stages, so that they give the same answers on the same
recording.
"""
