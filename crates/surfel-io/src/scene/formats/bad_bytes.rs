//! Every parser is fed random and mutated bytes: whatever comes, it returns.
