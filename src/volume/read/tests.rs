//! Every format as small files, written here by hand; truncated and lying ones are refused.

use std::io::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};

use super::*;

/// Reads without limits.
fn read(path: &Path, raw: Option<&RawLayout>) -> Result<Grid, Error> {
    super::read(path, raw, &Limits::default())
}

/// 3 x 2 x 2 voxels.
const SIZE: [usize; 3] = [3, 2, 2];
const VOXELS: [i16; 12] = [0, 1, -2, 300, 4, 5, 6, 7, -800, 9, 10, 1100];

fn bytes(big_endian: bool) -> Vec<u8> {
    VOXELS.iter().flat_map(|v| if big_endian { v.to_be_bytes() } else { v.to_le_bytes() }).collect()
}

fn gzip(plain: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(plain).unwrap();
    encoder.finish().unwrap()
}

fn zlib(plain: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(plain).unwrap();
    encoder.finish().unwrap()
}

fn text() -> Vec<u8> {
    VOXELS.map(|v| v.to_string()).join("\n").into_bytes()
}

struct Room(tempfile::TempDir);

impl Room {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn put(&self, name: &str, parts: &[&[u8]]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, parts.concat()).unwrap();
        path
    }
}

/// The grid holds the voxels, with spacing 1, 2, 3 from (10, 20, 30).
fn check(grid: &Grid) {
    assert_eq!(grid.size(), SIZE);
    for (k, &voxel) in VOXELS.iter().enumerate() {
        assert_eq!(grid.value([k % 3, k / 3 % 2, k / 6]), f64::from(voxel), "voxel {k}");
    }
    assert_eq!(grid.placement(), &Affine { origin: [10.0, 20.0, 30.0], ..Affine::spacing([1.0, 2.0, 3.0]) });
}

fn refused(path: &Path, part: &str) {
    let error = read(path, None).unwrap_err().to_string();
    assert!(error.contains(part), "{}: {error}", path.display());
    assert!(!error.contains('\n'));
}

fn nrrd(encoding: &str, endian: &str, more: &str) -> Vec<u8> {
    format!(
        "NRRD0004\n# comment\ntype: short\ndimension: 3\nsizes: 3 2 2\nspace directions: (1,0,0) (0,2,0) (0,0,3)\n\
         space origin: (10,20,30)\nkey:=value\nencoding: {encoding}\nendian: {endian}\n{more}\n"
    )
    .into_bytes()
}

#[test]
fn nrrd_attached_and_detached() {
    let room = Room::new();
    let raw = nrrd("raw", "big", "");
    check(&read(&room.put("a.nrrd", &[&raw, &bytes(true)]), None).unwrap());
    check(&read(&room.put("b.nrrd", &[&nrrd("gzip", "little", ""), &gzip(&bytes(false))]), None).unwrap());
    check(&read(&room.put("c.nrrd", &[&nrrd("ascii", "little", ""), &text()]), None).unwrap());
    room.put("d.raw", &[b"skipped\n", &bytes(false)]);
    let detached = nrrd("raw", "little", "data file: d.raw\nline skip: 1\n");
    check(&read(&room.put("d.nhdr", &[&detached]), None).unwrap());
    let from_end = nrrd("raw", "little", "data file: d.raw\nbyte skip: -1\n");
    check(&read(&room.put("e.nhdr", &[&from_end]), None).unwrap());
    refused(&room.put("f.nrrd", &[&raw, &bytes(true)[1..]]), "truncated");
    let packed = gzip(&bytes(false));
    refused(&room.put("g.nrrd", &[&nrrd("gzip", "little", ""), &packed[..packed.len() / 2]]), "damaged");
    refused(&room.put("h.nrrd", &[&nrrd("bzip2", "little", "")]), "bzip2");
    refused(&room.put("i.nrrd", &[b"NRRD0004\ntype: short\nsizes: 3 2\n\n"]), "three axes");
    refused(&room.put("k.nrrd", &[raw.trim_ascii_end(), b"\n"]), "no blank line");
    room.put("l.raw", &[&bytes(false)]);
    let named = nrrd("raw", "little", "data file: l.raw");
    check(&read(&room.put("l.nhdr", &[named.trim_ascii_end()]), None).unwrap());
    let keys = "key:=value\n".repeat(100_000);
    refused(&room.put("m.nrrd", &[&nrrd("raw", "big", &keys), &bytes(true)]), "longer than 1 MiB");
    refused(&room.put("n.nhdr", &[&nrrd("raw", "big", &keys), b"data file: l.raw\n"]), "longer than 1 MiB");
    refused(&room.put("o.nrrd", &[&nrrd("raw", "bigendian", ""), &bytes(true)]), "endian 'bigendian'");
    refused(&room.put("j.nhdr", &[&nrrd("raw", "little", "data file: none.raw\n")]), "none.raw");
}

#[test]
fn a_header_that_lies_takes_no_memory() {
    let room = Room::new();
    let lie = |size: &str, encoding: &str| {
        format!("NRRD0004\ntype: double\nsizes: {size}\nendian: little\nencoding: {encoding}\n\n")
            .into_bytes()
    };
    for encoding in ["raw", "gzip", "ascii"] {
        for size in ["100000 100000 100000", "4294967295 4294967295 4294967295", "9223372036854775807 9 9"] {
            let path = room.put("lie.nrrd", &[&lie(size, encoding), &gzip(&[0; 100])]);
            assert!(read(&path, None).is_err(), "{size} {encoding}");
        }
    }
    refused(&room.put("zero.nrrd", &[&lie("0 3 3", "raw")]), "size");
    for inside in ["ElementDataFile = LOCAL", "CompressedData = True\nElementDataFile = LOCAL"] {
        let header =
            format!("NDims = 3\nDimSize = 100000 100000 100000\nElementType = MET_DOUBLE\n{inside}\n");
        let path = room.put("lie.mha", &[header.as_bytes(), &zlib(&[0; 100])]);
        assert!(read(&path, None).is_err(), "{inside}");
    }
    for format in ["ascii", "binary"] {
        let file = format!(
            "<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\">\
             <ImageData WholeExtent=\"0 99999 0 99999 0 99999\" Origin=\"0 0 0\" Spacing=\"1 1 1\">\
             <Piece Extent=\"0 99999 0 99999 0 99999\"><PointData Scalars=\"v\"><DataArray type=\"Float64\" Name=\"v\" \
             format=\"{format}\">AAAA</DataArray></PointData></Piece></ImageData></VTKFile>"
        );
        assert!(read(&room.put("lie.vti", &[file.as_bytes()]), None).is_err(), "{format}");
    }
    let mut nifti = vec![0_u8; 352];
    nifti[..4].copy_from_slice(&348_i32.to_le_bytes());
    for (k, n) in [3_i16, 32_767, 32_767, 32_767].into_iter().enumerate() {
        nifti[40 + 2 * k..][..2].copy_from_slice(&n.to_le_bytes());
    }
    nifti[70..72].copy_from_slice(&64_i16.to_le_bytes());
    nifti[108..112].copy_from_slice(&352_f32.to_le_bytes());
    nifti[344..347].copy_from_slice(b"n+1");
    refused(&room.put("lie.nii", &[&nifti, &[0; 100]]), "truncated");
    refused(&room.put("lie.nii.gz", &[&gzip(&nifti)]), "truncated");
    let raw: RawLayout = "100000x100000x100000:f64".parse().unwrap();
    assert!(read(&room.put("x.raw", &[b"abc"]), Some(&raw)).is_err());
}

#[test]
fn metaimage_with_its_data_inside_and_beside() {
    let header = |rest: &str| {
        format!(
            "ObjectType = Image\nNDims = 3\nDimSize = 3 2 2\nElementType = MET_SHORT\nElementSpacing = 1 2 3\n\
             Offset = 10 20 30\nTransformMatrix = 1 0 0 0 1 0 0 0 1\n{rest}\n"
        )
        .into_bytes()
    };
    let room = Room::new();
    let local = header("BinaryDataByteOrderMSB = True\nElementDataFile = LOCAL");
    check(&read(&room.put("a.mha", &[&local, &bytes(true)]), None).unwrap());
    room.put("b.zraw", &[&zlib(&bytes(false))]);
    check(
        &read(&room.put("b.mhd", &[&header("CompressedData = True\nElementDataFile = b.zraw")]), None)
            .unwrap(),
    );
    refused(&room.put("c.mha", &[&local, &bytes(true)[..20]]), "truncated");
    refused(&room.put("d.mhd", &[&header("")]), "ElementDataFile");
}

#[test]
fn nifti_in_both_byte_orders() {
    let header = |big: bool| {
        let mut header = vec![0_u8; 352];
        let mut put = |at: usize, little: &[u8]| {
            let mut word = little.to_vec();
            if big {
                word.reverse();
            }
            header[at..at + word.len()].copy_from_slice(&word);
        };
        put(0, &348_i32.to_le_bytes());
        for (k, n) in [3_i16, 3, 2, 2].into_iter().enumerate() {
            put(40 + 2 * k, &n.to_le_bytes());
        }
        put(70, &4_i16.to_le_bytes());
        put(108, &352_f32.to_le_bytes());
        for (k, d) in [1.0_f32, 1.0, 2.0, 3.0].into_iter().enumerate() {
            put(76 + 4 * k, &d.to_le_bytes());
        }
        put(252, &1_i16.to_le_bytes());
        for (k, d) in [10.0_f32, 20.0, 30.0].into_iter().enumerate() {
            put(268 + 4 * k, &d.to_le_bytes());
        }
        header[344..347].copy_from_slice(b"n+1");
        header
    };
    let room = Room::new();
    // Where voxels begin, and how they are scaled.
    let with = |at: usize, value: f32| {
        let mut changed = header(false);
        changed[at..at + 4].copy_from_slice(&value.to_le_bytes());
        room.put("w.nii", &[&changed, &bytes(false)])
    };
    check(&read(&with(108, 0.0), None).unwrap());
    for offset in [1.0, 348.0, 351.0, -1.0, f32::NAN] {
        refused(&with(108, offset), "vox_offset");
    }
    for slope in [f32::NAN, f32::INFINITY, 0.0] {
        check(&read(&with(112, slope), None).unwrap());
    }
    let scaled = read(&with(112, -2.0), None).unwrap();
    assert_eq!((scaled.value([2, 1, 1]), scaled.type_range()), (-2200.0, (-65534.0, 65536.0)));
    for big in [false, true] {
        check(&read(&room.put("a.nii", &[&header(big), &bytes(big)]), None).unwrap());
        let whole = [header(big), bytes(big)].concat();
        check(&read(&room.put("b.nii.gz", &[&gzip(&whole)]), None).unwrap());
        refused(&room.put("c.nii", &[&header(big), &bytes(big)[..23]]), "truncated");
        refused(&room.put("d.nii.gz", &[&gzip(&whole[..370])]), "truncated");
    }
    refused(&room.put("e.nii", &[b"nothing of the kind"]), "NIfTI");
}

#[test]
fn nifti_2_begins_behind_its_header() {
    let room = Room::new();
    let file = |offset: i64, magic: &[u8]| {
        let mut header = vec![0_u8; 544];
        let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, &540_i32.to_le_bytes());
        put(4, magic);
        put(12, &4_i16.to_le_bytes());
        for (k, n) in [3_i64, 3, 2, 2].into_iter().enumerate() {
            put(16 + 8 * k, &n.to_le_bytes());
        }
        for (k, d) in [1.0_f64, 1.0, 2.0, 3.0].into_iter().enumerate() {
            put(104 + 8 * k, &d.to_le_bytes());
        }
        put(168, &offset.to_le_bytes());
        put(344, &1_i32.to_le_bytes());
        for (k, d) in [10.0_f64, 20.0, 30.0].into_iter().enumerate() {
            put(376 + 8 * k, &d.to_le_bytes());
        }
        room.put("two.nii", &[&header, &bytes(false)])
    };
    check(&read(&file(544, b"n+2"), None).unwrap());
    check(&read(&file(0, b"n+2"), None).unwrap());
    refused(&file(540, b"n+2"), "vox_offset");
    refused(&file(0, b"ni2"), "pair");
}

#[test]
fn nrrd_drops_the_axis_without_a_place() {
    let room = Room::new();
    let read = |sizes: &str, more: &str| {
        let header =
            format!("NRRD0004\ntype: short\nsizes: {sizes}\nencoding: raw\nendian: little\n{more}\n\n");
        read(&room.put("slab.nrrd", &[header.as_bytes(), &bytes(false)]), None).unwrap()
    };
    for (sizes, directions) in [
        ("1 4 3 1", "(2,0,0) (0,3,0) (0,0,4) none"),
        ("1 1 4 3", "none (2,0,0) (0,3,0) (0,0,4)"),
        ("1 1 4 3", "(2,0,0) none (0,3,0) (0,0,4)"),
    ] {
        let grid = read(sizes, &format!("space directions: {directions}"));
        assert_eq!((grid.size(), grid.placement().axes), ([1, 4, 3], Affine::spacing([2.0, 3.0, 4.0]).axes));
    }
    let grid = read("1 4 3 1", "spacings: 2 3 4 nan");
    assert_eq!((grid.size(), grid.placement().axes), ([1, 4, 3], Affine::spacing([2.0, 3.0, 4.0]).axes));
}

#[test]
fn nrrd_axes_are_those_of_space() {
    let room = Room::new();
    // Ends are those of cells unless they are said to be nodes.
    for (ends, centers) in [
        ("axis mins: 9.5 19 28.5\naxis maxs: 12.5 23 34.5", ""),
        ("axismins: 10 20 28.5\naxis maxs: 12 22 34.5", "centers: node node cell\n"),
        ("spacings: 1 2 3\naxis mins: 9.5 19 28.5", ""),
    ] {
        let header = format!(
            "NRRD0004\ntype: short\nsizes: 3 2 2\nencoding: raw\nendian: Little\n{ends}\n{centers}kinds: domain space ???\n\n"
        );
        check(&read(&room.put("a.nrrd", &[header.as_bytes(), &bytes(false)]), None).unwrap());
    }
    // A slice may end where it begins.
    let header = "NRRD0004\ntype: short\nsizes: 3 4 1\nencoding: raw\nendian: little\naxis mins: 0 0 5\naxis maxs: 3 8 5\n\n";
    let grid = read(&room.put("slice.nrrd", &[header.as_bytes(), &bytes(false)]), None).unwrap();
    assert_eq!(grid.placement().axes, Affine::spacing([1.0, 2.0, 1.0]).axes);
    for more in ["kinds: vector domain domain", "space directions: (1,0,0) (0,1,0) none"] {
        let header = format!("NRRD0004\ntype: short\nsizes: 3 2 2\nencoding: raw\nendian: big\n{more}\n\n");
        refused(&room.put("b.nrrd", &[header.as_bytes(), &bytes(true)]), "has components");
    }
}

#[test]
fn text_is_read_as_its_type() {
    for (element, least, wrong) in [
        (Element::I32, "-2147483648", ["1e9", "2147483648", "1.5"]),
        (Element::U32, "4294967295", ["-1", "4294967296", "nan"]),
        (Element::I8, "-128", ["128", "1e1", ""]),
    ] {
        assert!(element.parse(least.as_bytes(), 1).is_ok(), "{least}");
        for text in wrong {
            assert!(element.parse(text.as_bytes(), 1).is_err(), "{text}");
        }
    }
}

#[test]
fn vti_inline_and_appended() {
    let file = |attributes: &str, array: &str, data: &str, tail: &str| {
        format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" {attributes}>\
             <ImageData WholeExtent=\"0 2 0 1 0 1\" Origin=\"10 20 30\" Spacing=\"1 2 3\">\
             <Piece Extent=\"0 2 0 1 0 1\"><PointData Scalars=\"v\"><DataArray type=\"Int16\" Name=\"v\" {array}>{data}\
             </DataArray></PointData></Piece></ImageData>{tail}"
        )
        .into_bytes()
    };
    let end = "</VTKFile>";
    let plain = [24_u32.to_le_bytes().to_vec(), bytes(false)].concat();
    let packed = zlib(&bytes(false));
    let lengths: Vec<u8> =
        [1_u64, 24, 0, packed.len() as u64].into_iter().flat_map(u64::to_le_bytes).collect();
    let room = Room::new();
    let ascii = String::from_utf8(text()).unwrap();
    check(&read(&room.put("a.vti", &[&file("", "format=\"ascii\"", &ascii, end)]), None).unwrap());
    let inline = file("", "format=\"binary\"", &STANDARD.encode(&plain), end);
    check(&read(&room.put("b.vti", &[&inline]), None).unwrap());
    let wide = "header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\"";
    let both = STANDARD.encode(&lengths) + &STANDARD.encode(&packed);
    check(&read(&room.put("c.vti", &[&file(wide, "format=\"binary\"", &both, end)]), None).unwrap());
    let appended = "format=\"appended\" offset=\"0\"";
    let raw = "<AppendedData encoding=\"raw\">\n_";
    let close = b"\n</AppendedData></VTKFile>";
    check(&read(&room.put("d.vti", &[&file("", appended, "", raw), &plain, close]), None).unwrap());
    let zipped = [lengths.clone(), packed.clone()].concat();
    check(&read(&room.put("e.vti", &[&file(wide, appended, "", raw), &zipped, close]), None).unwrap());
    let base64 = "<AppendedData encoding=\"base64\">\n_";
    check(
        &read(&room.put("f.vti", &[&file(wide, appended, "", base64), both.as_bytes(), close]), None)
            .unwrap(),
    );
    refused(&room.put("g.vti", &[&file("", appended, "", raw), &plain[..20]]), "truncated");
    refused(&room.put("h.vti", &[b"<VTKFile"]), "XML");
    for offset in ["", "offset=\"-4\"", "offset=\"x\""] {
        let array = format!("format=\"appended\" {offset}");
        refused(&room.put("i.vti", &[&file("", &array, "", raw), &plain, close]), "offset");
    }
}

#[test]
fn raw_voxels_and_every_type() {
    let room = Room::new();
    let layout: RawLayout = "3x2x2:i16:be:1,2,3".parse().unwrap();
    let grid = read(&room.put("a.raw", &[&bytes(true)]), Some(&layout)).unwrap();
    assert_eq!(grid.value([2, 1, 1]), 1100.0);
    assert_eq!(grid.placement().axes[2], [0.0, 0.0, 3.0]);
    for (name, little, range) in [
        ("u8", vec![7_u8], (0.0, 255.0)),
        ("i8", vec![7], (-128.0, 127.0)),
        ("u16", 7_u16.to_le_bytes().to_vec(), (0.0, 65_535.0)),
        ("u32", 7_u32.to_le_bytes().to_vec(), (0.0, 4_294_967_295.0)),
        ("i32", 7_i32.to_le_bytes().to_vec(), (-2_147_483_648.0, 2_147_483_647.0)),
        ("f32", 7_f32.to_le_bytes().to_vec(), (0.0, 1.0)),
        ("f64", 7_f64.to_le_bytes().to_vec(), (0.0, 1.0)),
    ] {
        let mut big = little.clone();
        big.reverse();
        for (order, bytes) in [("le", little), ("be", big)] {
            let layout: RawLayout = format!("1x1x1:{name}:{order}").parse().unwrap();
            let grid = read(&room.put("b.raw", &[&bytes]), Some(&layout)).unwrap();
            assert_eq!((grid.value([0; 3]), grid.type_range()), (7.0, range), "{name} {order}");
        }
    }
    for bad in ["", "3x2:u8", "3x2x2", "3x2x2:u7", "0x2x2:u8", "3x2x2:u8:1,0,1", "3x2x2:u8:1,1"] {
        assert!(bad.parse::<RawLayout>().is_err(), "{bad}");
    }
    let long = room.put("long.raw", &[&bytes(true), b"x"]);
    let error = read(&long, Some(&layout)).unwrap_err().to_string();
    assert!(error.contains("long.raw: 25 bytes where 3x2x2 voxels have 24"), "{error}");
    let error = read(&room.put("short.raw", &[&bytes(true)[1..]]), Some(&layout)).unwrap_err().to_string();
    assert!(
        error.contains("short.raw: 23 bytes where 3x2x2 voxels have 24") && error.contains("--raw"),
        "{error}"
    );
    let packed = room.put("long.raw.gz", &[&gzip(&[bytes(true), vec![0]].concat())]);
    assert!(read(&packed, Some(&layout)).is_err());
    let nan = room.put("nan.raw", &[&f32::NAN.to_le_bytes()]);
    assert!(read(&nan, Some(&"1x1x1:f32".parse().unwrap())).is_err());
    refused(&room.put("c.txt", &[b"hello"]), "not a volume");
}

#[test]
fn headers_stay_in_their_folder_and_name_regular_files() {
    let room = Room::new();
    std::fs::create_dir(room.0.path().join("in")).unwrap();
    room.put("v.raw", &[&bytes(true)]);
    room.put("in/v.raw", &[&bytes(true)]);
    let detached = |file: &str| nrrd("raw", "big", &format!("data file: {file}"));
    let outside = room.put("in/up.nhdr", &[&detached("../v.raw")]);
    refused(&outside, "--allow-outside");
    refused(&room.put("in/abs.nhdr", &[&detached("/dev/zero")]), "--allow-outside");
    check(&super::read(&outside, None, &Limits { outside: true, ..Limits::default() }).unwrap());
    check(&read(&room.put("in/same.nhdr", &[&detached("./v.raw")]), None).unwrap());
    let device = room.put("device.nhdr", &[&detached("/dev/zero")]);
    let error = super::read(&device, None, &Limits { outside: true, ..Limits::default() }).unwrap_err();
    assert!(error.to_string().contains("not a regular file"), "{error}");
}

#[test]
fn no_more_memory_is_taken_than_is_granted() {
    let room = Room::new();
    let file = room.put("v.nrrd", &[&nrrd("raw", "big", ""), &bytes(true)]);
    // Twelve voxels of 2 bytes, and as coefficients 4 bytes more.
    let with = |bytes: u64| super::read(&file, None, &Limits { bytes, ..Limits::default() });
    assert!(with(12 * 6 - 1).is_err());
    check(&with(12 * 6).unwrap());
    let gz = room.put("v.nhdr", &[&nrrd("gzip", "big", "data file: v.gz")]);
    room.put("v.gz", &[&gzip(&bytes(true))]);
    let error =
        super::read(&gz, None, &Limits { bytes: 12 * 6 - 1, ..Limits::default() }).unwrap_err().to_string();
    assert!(error.contains("3x2x2 voxels") && error.contains("--memory"), "{error}");
    check(&super::read(&gz, None, &Limits { bytes: 12 * 6, ..Limits::default() }).unwrap());
}

#[test]
fn voxels_of_no_length_are_refused() {
    let room = Room::new();
    let spacing = |z: &str| {
        let header = format!(
            "NDims = 3\nDimSize = 3 2 2\nElementType = MET_SHORT\nElementSpacing = 1 1 {z}\nElementDataFile = LOCAL\n"
        );
        room.put("s.mha", &[header.as_bytes(), &bytes(false)])
    };
    for z in ["1e-320", "1e-300", "1e300"] {
        refused(&spacing(z), "long");
    }
}

#[cfg(unix)]
#[test]
fn texts_are_read_from_small_regular_files() {
    let room = Room::new();
    let pipe = room.0.path().join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let long = room.put("long", &[&vec![b' '; 1 + LONGEST_TEXT as usize]]);
    let broken = room.put("broken", &[b"\xff"]);
    for (path, why) in [
        (&pipe, "cannot read the scene: it is not a regular file"),
        (&PathBuf::from("/dev/zero"), "cannot read the scene: it is not a regular file"),
        (&long, "cannot read the scene: it has more than 16777216 bytes"),
        (&broken, "cannot read the scene: it is not UTF-8"),
        (&room.0.path().join("none"), "cannot read the scene: No such file"),
    ] {
        let error = super::text(path, "read the scene").unwrap_err().to_string();
        assert!(error.contains(why), "{error}");
    }
}

#[test]
fn gzip_members_are_held_against_their_checksums() {
    let plain = bytes(false);
    let inflate = |packed: &[u8]| inflate::inflate(packed, Coding::Gzip, plain.len());
    let whole = gzip(&plain);
    let two = [gzip(&plain[..7]), gzip(&plain[7..])].concat();
    let behind = [&whole[..], b"left behind"].concat();
    for packed in [&whole, &two, &behind] {
        assert_eq!(inflate(packed).as_ref(), Ok(&plain));
    }
    for (mut packed, from) in [(whole.clone(), whole.len() - 8), (two.clone(), two.len() - 8)] {
        for at in from..packed.len() {
            packed[at] ^= 1;
            assert!(inflate(&packed).unwrap_err().starts_with("damaged"), "byte {at}");
            packed[at] ^= 1;
        }
    }
}
