"""Skeleton: a meter that answers requests over TCP."""

from cellwatt.testing.skeleton.driver import SkeletonDriver, SkeletonSettings

__all__ = ["SkeletonDriver", "SkeletonSettings"]
