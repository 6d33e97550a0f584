"""Stages: a source of skeletons, and the characters that its performers drive."""
