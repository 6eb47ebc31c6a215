//! Whoever is at the other end, and whatever a file says: an error in time, no panic, no memory without bounds.

use std::io::{Read, Write};
use std::net::TcpListener;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

use super::*;

/// A server that answers whatever it is asked by the same bytes, again and again.
fn answering(bytes: Vec<u8>, times: usize) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    std::thread::spawn(move || {
        while let Ok((mut stream, _)) = listener.accept() {
            let bytes = bytes.clone();
            std::thread::spawn(move || {
                let mut request = [0; 4096];
                let _ = stream.read(&mut request);
                for _ in 0..times {
                    if stream.write_all(&bytes).is_err() {
                        return;
                    }
                }
                std::thread::sleep(Duration::from_secs(2));
            });
        }
    });
    address
}

/// A frame with a body, as `docs/host.md` has it, for bodies that need no more than one block.
fn framed(body: &[u8]) -> Vec<u8> {
    let mut bytes = body.to_vec();
    bytes.extend(crc(body).to_le_bytes());
    let mut stuffed = Vec::new();
    for block in bytes.split(|byte| *byte == 0) {
        stuffed.push(u8::try_from(block.len() + 1).unwrap());
        stuffed.extend(block);
    }
    stuffed.push(0);
    stuffed
}

/// CRC-32 of IEEE 802.3, bit by bit.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ if crc & 1 == 1 { 0xEDB8_8320 } else { 0 })
    })
}

#[test]
fn answers_without_end_are_an_error_in_time() {
    let folder = Folder::new("transports_flood");
    compiled(&folder.0, "motor_pid", HOSTED[0].1);
    let design = Design::open(&folder.0).unwrap();
    let mut noise = ChaCha8Rng::seed_from_u64(3);
    let random: Vec<u8> = (0..4096).map(|_| noise.random_range(1..=255)).collect();
    let floods = [
        ("bytes without an end", vec![7; 4096], 4000),
        ("noise", random, 4000),
        ("empty frames", vec![0; 4096], 4000),
        ("answers to something else", framed(&[77, 0, 1, 0, 0, 0]), 200_000),
        ("words that nobody asked for", framed(&[1, 0, 2, 0, 0, 0, 9, 9, 9, 9, 9, 9, 9, 9]), 1),
        ("half a frame", framed(&[1, 0, 2, 0, 0, 0])[..5].to_vec(), 1),
        ("an answer of another version", framed(&[1, 0, 9, 0, 0, 0]), 1),
    ];
    for (what, bytes, times) in floods {
        let transport = Transport::Tcp(answering(bytes, times));
        let error = within(IN_TIME, what, || transport.open(&design, &Settings::default()));
        assert!(["late", "damaged", "foreign"].contains(&error.kind()), "{what}: {error}");
    }
}

#[test]
fn a_server_outlives_whoever_connects() {
    let folder = Folder::new("transports_visitors");
    compiled(&folder.0, "motor_pid", HOSTED[0].1);
    let design = Design::open(&folder.0).unwrap();
    let address = served(bank(&design));
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for visit in 0..40 {
        let mut stream = std::net::TcpStream::connect(&address).unwrap();
        let bytes: Vec<u8> = match visit % 4 {
            // A whole frame with any body, and noise.
            0 | 1 => framed(&(0..random.random_range(1..60)).map(|_| random.random()).collect::<Vec<u8>>()),
            2 => (0..random.random_range(1..5000)).map(|_| random.random()).collect(),
            // Reads of 65,535 words.
            _ => framed(&[1, 1, 0, 0, 0, 0, 0, 255, 255]),
        };
        let _ = stream.write_all(&bytes);
    }
    std::thread::sleep(Duration::from_millis(300));
    let timeout = Some(Duration::from_secs(5));
    let transport = Transport::Tcp(address);
    let engine = transport.open(&design, &Settings { timeout, ..Settings::default() }).unwrap();
    let mut host = Host::over(design.clone(), engine).unwrap();
    let expected = program(&mut model(&folder.0), 30, 5);
    assert_same("motor_pid", ["model", "a server with visitors"], &expected, &program(&mut host, 30, 5));
}

#[test]
fn a_map_with_other_numbers_is_refused_or_used_but_never_a_panic() {
    let folder = Folder::new("transports_maps");
    compiled(&folder.0, TUNED, "--pes 2 --outputs memory --host restart,states");
    let path = folder.0.join("tuned_map.json");
    let text = fs::read_to_string(&path).unwrap();
    let map: serde_json::Value = serde_json::from_str(&text).unwrap();
    let mut places = Vec::new();
    numbers(&map, &mut String::new(), &mut places);
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let mut refused = 0;
    for round in 0..400 {
        let mut other = map.clone();
        let at = &places[random.random_range(0..places.len())];
        let new = [0, -1, 1, 63, 64, 65, 1 << 20, i64::from(u32::MAX), i64::MAX, i64::MIN][round % 10];
        *other.pointer_mut(at).unwrap() = new.into();
        fs::write(&path, other.to_string()).unwrap();
        let used = catch_unwind(AssertUnwindSafe(|| {
            let design = Design::open(&folder.0)?;
            let mut host = Host::over(design.clone(), Box::new(Model::open(&design)?))?;
            host.run(1)?;
            host.read_words()?;
            over(&design, bank(&design)).map(drop)
        }));
        match used {
            Ok(Ok(())) => {}
            Ok(Err(_)) => refused += 1,
            Err(_) => panic!("{at} = {new} panics"),
        }
    }
    assert!(refused > 40, "{refused} of 400 are refused");
}

/// Places of all numbers in a value.
fn numbers(value: &serde_json::Value, at: &mut String, places: &mut Vec<String>) {
    let mut below = |key: String, value: &serde_json::Value| {
        let length = at.len();
        at.push('/');
        at.push_str(&key);
        numbers(value, at, places);
        at.truncate(length);
    };
    match value {
        serde_json::Value::Array(list) => {
            list.iter().enumerate().for_each(|(key, value)| below(key.to_string(), value))
        }
        serde_json::Value::Object(map) => map.iter().for_each(|(key, value)| below(key.clone(), value)),
        serde_json::Value::Number(_) => places.push(at.clone()),
        _ => {}
    }
}
