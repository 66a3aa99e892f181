"""Papers, each a folder of claims, and the engine that measures, judges and shows claims."""
