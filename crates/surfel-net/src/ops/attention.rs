//! Attention of tokens to tokens: burn's own, and a count of what it multiplies.
//!
//! Invariant: the numbers are burn's.

use super::count;
use burn::tensor::Tensor;
use burn::tensor::ops::AttentionModuleOptions;

/// Softmax of queries times keys plus `bias`, times values; queries `[batch, heads, queries, dim]`, keys and values
/// `[batch, heads, keys, dim]`, bias `[batch, heads, queries, keys]` or broadcastable to it.
pub(crate) fn attention(query: Tensor<4>, key: Tensor<4>, value: Tensor<4>, bias: Option<Tensor<4>>) -> Tensor<4> {
    let ([batch, heads, queries, dim], [_, _, keys, _]) = (query.dims(), key.dims());
    count::tell_product(&[2, batch, heads, queries, keys, dim]);
    burn::tensor::module::attention(query, key, value, None, bias, AttentionModuleOptions::default())
}
