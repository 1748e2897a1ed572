"""Runs on disk: folders, frames, and how a run goes on."""
