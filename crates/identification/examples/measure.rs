use std::io::BufReader;
fn main() {
    for file in std::env::args().skip(1) {
        let begun = std::time::Instant::now();
        let table = adaptive_fmu_identification::csv::Table::read(BufReader::new(std::fs::File::open(&file).unwrap()), &[]).unwrap();
        println!("{}", adaptive_fmu_identification::measure(&file, &table, begun));
    }
}
