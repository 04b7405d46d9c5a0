//! The networks, in burn: pretrained image features.
