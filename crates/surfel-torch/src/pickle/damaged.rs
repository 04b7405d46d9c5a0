//! The machine is fed programs that are random, damaged or malicious: it returns, and soon.

use super::parse;
use crate::error::Fault;
use crate::value::Value;
use proptest::prelude::*;

/// A program in protocol 2.
fn program(body: &[u8]) -> Vec<u8> {
    [b"\x80\x02", body, b"."].concat()
}

fn fault(body: &[u8]) -> String {
    match parse(&program(body)).unwrap_err() {
        Fault::Text(reason) => reason,
        Fault::Forbidden(global) => format!("forbidden {global}"),
    }
}

/// A tensor of 2 x 3 floats, as protocol 2 writes it, in a dict with everything else.
const SEED: &[u8] = b"\x80\x02}q\x00(X\x01\x00\x00\x00xq\x01ctorch._utils\n_rebuild_tensor_v2\nq\x02((X\x07\x00\x00\x00storageq\x03\
ctorch\nFloatStorage\nq\x04X\x01\x00\x00\x000q\x05X\x03\x00\x00\x00cpuq\x06K\x06tq\x07QK\x00K\x02K\x03\x86q\x08K\x03K\x01\x86q\x09\
\x89ccollections\nOrderedDict\nq\x0a)Rq\x0btq\x0cRq\x0dX\x01\x00\x00\x00yq\x0e](K\x01M\x00\x01J\xff\xff\xff\xff\x8a\x03\x01\x02\x03\
G?\xe0\x00\x00\x00\x00\x00\x00NX\x02\x00\x00\x00abh\x0beK\x09(\x88\x89tu.";

#[test]
fn the_seed_is_valid() {
    let value = parse(SEED).unwrap();
    assert_eq!(value.get("x").unwrap().as_tensor().unwrap().shape(), [2, 3]);
    assert_eq!(value.get("y").unwrap().as_list().unwrap()[3], Value::Int(0x30201));
}

#[test]
fn only_the_listed_names_exist() {
    for (module, name) in [
        ("os", "system"),
        ("builtins", "eval"),
        ("torch", "load"),
        ("torch._utils", "_rebuild_qtensor"),
        ("collections", "defaultdict"),
        ("numpy.core.multiarray", "_reconstruct"),
        ("pathlib", "PosixPath"),
    ] {
        let by_text = fault(format!("c{module}\n{name}\n)R").as_bytes());
        assert_eq!(by_text, format!("forbidden {module}.{name}"));
        let texts = [module, name].map(|text| [&[0x8c, text.len() as u8], text.as_bytes()].concat()).concat();
        assert_eq!(fault(&[&texts[..], b"\x93)R"].concat()), format!("forbidden {module}.{name}"));
    }
    assert_eq!(fault(b"cos\nsys\x1b[2Jtem\n"), "forbidden os.sys\\u{1b}[2Jtem");
}

#[test]
fn opcodes_that_make_objects_are_refused() {
    // INST, OBJ, NEWOBJ, NEWOBJ_EX, EXT1, PERSID, sets, protocol 0 text.
    for opcode in [b"i".as_slice(), b"o", b"\x81", b"\x92", b"\x82", b"P", b"\x8f", b"\x91", b"I", b"S", b"\x97"] {
        assert!(fault(opcode).contains("torch.save does not write"), "{opcode:?}");
    }
    assert!(fault(b"\x80\x01").contains("protocol 1"));
}

#[test]
fn lengths_that_lie_reserve_nothing() {
    let huge = [0xff; 8];
    for opcode in [b'X', 0x8d, b'B', 0x8e, 0x8b, 0x95] {
        let body = [&[opcode], &huge[..]].concat();
        assert!(parse(&program(&body)).is_err(), "{opcode}");
    }
    assert!(fault(&[b"\x8a\x09", &[1; 9][..]].concat()).contains("more than 64 bits"));
    // A storage of 2^62 elements is only a description until it is read.
    let body = b"((X\x07\x00\x00\x00storagectorch\nFloatStorage\nX\x01\x00\x00\x000NX\x01\x00\x00\x00atQ1K\x01";
    assert_eq!(fault(&body[1..]), "describes a storage without a usable length");
    let tensor = b"ctorch._utils\n_rebuild_tensor_v2\n((X\x07\x00\x00\x00storagectorch\nFloatStorage\nX\x01\x00\x00\x000N\
\x8a\x08\x00\x00\x00\x00\x00\x00\x00\x40tQK\x00\x8a\x05\x00\x00\x00\x00\x01\x8a\x05\x00\x00\x00\x00\x01\x86K\x00K\x00\x86\x89)tR";
    assert!(parse(&program(tensor)).is_err());
}

#[test]
fn stacks_and_marks_are_checked() {
    for body in [
        b"0".as_slice(),
        b"1",
        b"2",
        b"t",
        b"\x87",
        b"(0",
        b"K\x01(\x85",
        b"q\x00",
        b"h\x00",
        b"R",
        b"b",
        b"Q",
        b"K\x01K\x01R",
    ] {
        assert!(parse(&program(body)).is_err(), "{body:?}");
    }
    assert!(fault(b"}(K\x01u").contains("a key and no value"));
    assert!(fault(b"K\x01K\x02a").contains("no list"));
    assert!(fault(b"ctorch\nFloatStorage\n)R").contains("never writes"));
    assert!(fault(b"ctorch\nFloatStorage\n").contains("bare type"));
    assert!(fault(b"K\x01Q").contains("outside itself"));
    assert!(parse(b"\x80\x02K\x01").is_err());
}

#[test]
fn a_list_inside_itself_is_an_error() {
    assert!(fault(b"]q\x00h\x00a").contains("nests"));
    assert!(fault(b"}q\x00K\x01h\x00s").contains("nests"));
    let deep = [vec![b']'; 5000], vec![b'a'; 4999]].concat();
    assert!(fault(&deep).contains("nests"));
}

#[test]
fn doubling_forty_times_is_an_error() {
    let mut body = b"](K\x01K\x01eq\x00".to_vec();
    for level in 0..40 {
        body.extend([b']', b'(', b'h', level, b'h', level, b'e', b'q', level + 1]);
    }
    assert!(fault(&body).contains("more than 4194304 values"));
}

#[test]
fn an_endless_program_is_stopped() {
    let body = [b"N0".repeat(5 << 20), vec![b'N']].concat();
    assert!(fault(&body).contains("steps"));
}

#[test]
fn a_string_said_often_is_kept_once() {
    // 1 MiB said 500,000 times: half a terabyte if copied.
    let mut body = [b"X\x00\x00\x10\x00".as_slice(), &[b'x'; 1 << 20], b"q\x000]("].concat();
    body.extend(b"h\x00".repeat(500_000));
    body.push(b'e');
    assert_eq!(parse(&program(&body)).unwrap().as_list().unwrap().len(), 500_000);
}

proptest! {
    #[test]
    fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let _ = parse(&bytes);
        let _ = parse(&program(&bytes));
    }

    #[test]
    fn random_opcodes_never_panic(
        picks in proptest::collection::vec((any::<prop::sample::Index>(), 0u8..4), 0..200),
    ) {
        const OPCODES: &[u8] = b"N\x88KMX\x8cC)]}(tld\x85\x86\x87aesu012qrhjRbQ\x94\x93";
        let body: Vec<u8> = picks.iter().flat_map(|(pick, byte)| [OPCODES[pick.index(OPCODES.len())], *byte]).collect();
        let _ = parse(&program(&body));
    }

    #[test]
    fn damaged_programs_never_panic(
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        keep in 0.3f64..1.2,
    ) {
        let mut bytes = SEED.to_vec();
        for (index, byte) in &edits {
            let at = index.index(bytes.len());
            bytes[at] = *byte;
        }
        bytes.truncate((keep * bytes.len() as f64) as usize);
        let _ = parse(&bytes);
    }
}
