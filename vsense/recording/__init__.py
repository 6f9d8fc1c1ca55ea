"""Recordings: everything a run told, in one MCAP file; read, replayed, exported, tracked again."""
