"""The way of a scan, stage by stage: encode, map, query.

The live nodes, the replay and the command line all drive these stages and nothing else, so that they give the same
answer on the same recording.
"""
