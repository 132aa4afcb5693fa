use super::*;

fn read(text: &str) -> Result<Table, Fault> {
    Table::read(text.as_bytes(), &["record"])
}

fn values(text: &str) -> Vec<Vec<f64>> {
    read(text).unwrap().columns.into_iter().map(|column| column.values).collect()
}

fn refusal(text: &str) -> String {
    read(text).unwrap_err().to_string()
}

#[test]
fn separators_and_decimal_marks_are_recognised() {
    let expected = vec![vec![0.0, 0.5], vec![1.25, -2e-3]];
    for text in [
        "time,u\n0,1.25\n0.5,-2e-3\n",
        "time;u\n0;1,25\n0,5;-2e-3\n",
        "time;u\n0;1.25\n0.5;-2e-3\n",
        "time\tu\n0\t1,25\n0,5\t-0,002\n",
        "\u{feff}\"time\";\"u\"\r\n0;1,25\r\n\r\n0,5;\"-0,002\"\r\n",
        "time, u,\n0, 1.25,\n0.5 , -2e-3,\n",
        "time,u\n0,1.25,\n0.5,-2e-3,\n",
        "time,u,\n0,1.25\n0.5,-2e-3\n",
    ] {
        assert_eq!(values(text), expected, "{text}");
    }
}

#[test]
fn decimal_commas_are_refused_where_they_separate() {
    assert_eq!(
        refusal("time,u\n0,1\n0,5,2,5\n"),
        "line 3: has 4 values, but there are 2 columns; with decimal commas the separator must be ; or a tab"
    );
    assert_eq!(refusal("time,u\n0,\"1,5\"\n"), "line 2: u = 1,5: a decimal comma needs ; or a tab as the separator");
    assert_eq!(
        refusal("time;u\n0,5;1\n1.5;1\n"),
        "line 3: time = 1.5: numbers above have `,` as the decimal mark, without separators of thousands"
    );
    assert!(refusal("time;u\n1;1.234,5\n").starts_with("line 2: u = 1.234,5: numbers above have `,`"));
}

#[test]
fn cells_may_be_empty_booleans_or_nan() {
    let columns = values("time,u,v\n0,,true\n1,NaN,FALSE\n2,nan,1\n");
    assert_eq!(columns[2], [1.0, 0.0, 1.0]);
    assert!(columns[1].iter().all(|value| value.is_nan()));
    for wrong in ["inf", "-Infinity", "abc", "1e999", "1 000", "--"] {
        let error = refusal(&format!("time,u\n0,{wrong}\n1,2\n"));
        assert_eq!(error, format!("line 2: u = {wrong}: must be a finite number, true, false, NaN or empty"));
    }
}

#[test]
fn units_are_in_brackets_or_in_a_second_row_and_indices_are_none() {
    let units = |text: &str| -> Vec<(String, Option<String>)> {
        read(text).unwrap().columns.into_iter().map(|column| (column.name, column.unit)).collect()
    };
    let named = |name: &str, unit: &str| (name.to_owned(), Some(unit.to_owned()).filter(|unit| !unit.is_empty()));
    let expected = [named("time", "s"), named("speed", "rpm"), named("x[1]", ""), named("K[1,2]", "N.m")];
    assert_eq!(units("time [s],speed[rpm],x[1],K[1,2] [N.m]\n0,1,2,3\n"), expected);
    assert_eq!(units("time;speed;x[1];K[1,2]\n[s];[rpm];;N.m\n0;1;2;3\n"), expected);
    assert_eq!(units("time;speed;x[1];K[1,2]\ns;rpm;-;N.m\n0;1;2;3\n")[2], named("x[1]", "-"));
    assert_eq!(values("time,u\ns,V\n0,1\n")[1], [1.0]);
    assert_eq!(refusal("time,u\ns\n0,1\n"), "line 2: has 1 units, but there are 2 columns");
    // Units are given in one place: this row is a wrong one.
    assert!(refusal("time [s],u\ns,V\n0,1\n").starts_with("line 2: time = s: must be a finite number"));
}

#[test]
fn a_column_of_texts_keeps_them() {
    let table = read("record,time,u\nfirst,0,1\nsecond,0,2\n").unwrap();
    assert_eq!(table.column("record").unwrap().texts, ["first", "second"]);
    assert_eq!(table.lines, [2, 3]);
}

#[test]
fn wrong_tables_are_refused_with_their_line() {
    assert_eq!(refusal(""), "line 1: must be the names of the columns");
    assert_eq!(refusal("time,u\n"), "line 2: the table must have at least one line of values");
    assert_eq!(refusal("0,1\n2,3\n"), "line 1: must be the names of the columns, not numbers");
    assert_eq!(refusal("time,u,u\n0,1,2\n"), "line 1: `u` is the name of two columns");
    assert_eq!(refusal("time,,u\n0,1,2\n"), "line 1: column 2 has no name");
    assert_eq!(refusal("time,u\n0,1\n\n2\n"), "line 4: has 1 values, but there are 2 columns");
    assert_eq!(refusal("time,u\n0,\"1\n"), "line 2: a quote does not end");
    let bytes = [b"time,u\n0,\xff".as_slice(), b"1\n"].concat();
    assert_eq!(
        Table::read(&bytes[..], &[]).unwrap_err().to_string(),
        "line 2: is not UTF-8: save the file as CSV UTF-8"
    );
    let long = format!("time,u\n0,{}\n", "1".repeat(5_000_000));
    assert_eq!(refusal(&long), "line 2: is longer than 4194304 bytes");
}
