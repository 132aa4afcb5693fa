//! Identification.
#![allow(dead_code, unused_imports, missing_docs)]
pub mod csv;
mod data;
mod estimate;
mod finding;
mod layout;
mod linear;
mod marquardt;
mod predictor;
mod record;
mod sampled;
mod starts;
mod structure;
mod text;
pub fn measure(name: &str, table: &csv::Table, begun: std::time::Instant) -> String {
    let record = record::Record::of_table(name, table, None).unwrap().remove(0);
    let of = |l: &str| record.columns.iter().map(|c| c.name.clone()).filter(|n| n.starts_with(l)).collect::<Vec<_>>();
    let signals = record::Signals { inputs: of("u"), measured: of("x") };
    let records = [record];
    let source = data::Source::new(&records, &signals, &[], signals.measured.len() + 2).unwrap();
    let data = source.data(&vec![0..records[0].len()], None, None).unwrap();
    let layout = layout::Layout::new(&structure::Structure::default().entries(&signals, true).unwrap(), &data.scaling, 1);
    match estimate::estimate(&data, &layout, sampled::Hold::ZeroOrder, usize::MAX) {
        Err(refusal) => format!("{{\"file\":\"{name}\",\"refusal\":\"{}\"}}", refusal.text),
        Ok(found) => {
            let rows = |fit: &marquardt::Fit| { let m = layout.matrices(&fit.unknowns[..layout.count()]).physical(&data.scaling);
               format!("{{\"A\":{:?},\"B\":{:?},\"loss\":{:?}}}", m.a.row_iter().map(|r| r.iter().copied().collect::<Vec<_>>()).collect::<Vec<_>>(), m.b.row_iter().map(|r| r.iter().copied().collect::<Vec<_>>()).collect::<Vec<_>>(), fit.value.loss)};
            format!("{{\"file\":\"{name}\",\"k\":{},\"oe\":{},\"method\":\"{:?}\",\"seconds\":{}}}", rows(&found.innovation), found.output_error.as_ref().map_or("null".into(), rows), found.method, begun.elapsed().as_secs_f64())
        }
    }
}
