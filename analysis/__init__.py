"""Measurements on recorded data: arrays in, one small frozen result per measurement out."""
