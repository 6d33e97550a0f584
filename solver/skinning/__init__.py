"""Skin weights of bones, for programs that animate a surface by rotations of joints."""
