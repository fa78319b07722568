"""The room that all drivers share: each thing that several need, once. It knows none of them."""
