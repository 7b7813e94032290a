//! The smallest EXR file: uncompressed scan lines of 32-bit floats, for pictures that a description holds decoded.

/// The bytes of an EXR file (OpenEXR 2.0 file layout) of 1 to 4 channels: Y, RG, RGB or RGBA.
pub fn to_bytes(width: u32, height: u32, channels: u32, data: &[f32]) -> Vec<u8> {
    let names: &[&str] = match channels {
        1 => &["Y"],
        2 => &["R", "G"],
        3 => &["R", "G", "B"],
        _ => &["R", "G", "B", "A"],
    };
    // Channels are stored in alphabetic order.
    let mut order: Vec<usize> = (0..names.len()).collect();
    order.sort_by_key(|i| names[*i]);
    let mut out = vec![0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];
    let mut attribute = |name: &str, kind: &str, value: &[u8]| {
        for text in [name, kind] {
            out.extend(text.as_bytes());
            out.push(0);
        }
        out.extend((value.len() as u32).to_le_bytes());
        out.extend(value);
    };
    let mut list = Vec::new();
    for i in &order {
        list.extend(names[*i].as_bytes());
        list.push(0);
        // 32-bit float, not perceptually linear, sampled at every pixel.
        for v in [2u32, 0, 1, 1] {
            list.extend(v.to_le_bytes());
        }
    }
    list.push(0);
    let window: Vec<u8> = [0, 0, width.saturating_sub(1), height.saturating_sub(1)].iter().flat_map(|v: &u32| v.to_le_bytes()).collect();
    attribute("channels", "chlist", &list);
    attribute("compression", "compression", &[0]);
    attribute("dataWindow", "box2i", &window);
    attribute("displayWindow", "box2i", &window);
    attribute("lineOrder", "lineOrder", &[0]);
    attribute("pixelAspectRatio", "float", &1.0f32.to_le_bytes());
    attribute("screenWindowCenter", "v2f", &[0; 8]);
    attribute("screenWindowWidth", "float", &1.0f32.to_le_bytes());
    out.push(0);
    let line_size = width as usize * names.len() * 4;
    let table_end = out.len() + height as usize * 8;
    for y in 0..height as usize {
        out.extend(((table_end + y * (line_size + 8)) as u64).to_le_bytes());
    }
    for (y, line) in data.chunks_exact((width as usize * names.len()).max(1)).take(height as usize).enumerate() {
        out.extend((y as u32).to_le_bytes());
        out.extend((line_size as u32).to_le_bytes());
        for channel in &order {
            out.extend(line.iter().skip(*channel).step_by(names.len()).flat_map(|v| v.to_le_bytes()));
        }
    }
    out
}
