"""Skeleton: a meter that answers questions over TCP."""

from cellwatt.testing.skeleton.driver import SkeletonDriver, SkeletonSettings

__all__ = ["SkeletonDriver", "SkeletonSettings"]
