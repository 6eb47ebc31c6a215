// SPDX-License-Identifier: MIT OR Apache-2.0
//
// Behaviour of the block RAM of Virtex-6, of which yosys 0.70 brings ports and timing only, as far as its netlists use it:
// words of 9, 18, 36 or 72 bits, no output registers, no cascades, no error correction. These are not the vendor's models:
// the places of bits are those of yosys' own mapping; nothing was compared with a device.

// HALF: bytes of a port's data. A word of twice as many is read by port A and written by port B, on the pins of both.
module block_ram #(
  parameter BYTES = 2048, HALF = 2, MODE = "TDP", WRITE_MODE_A = "", WRITE_MODE_B = "",
  parameter READ_A = 0, READ_B = 0, WRITE_A = 0, WRITE_B = 0, PLAIN = 1,
  parameter [9 * HALF - 1:0] INIT_A = 0, INIT_B = 0, SRVAL_A = 0, SRVAL_B = 0,
  parameter [8 * BYTES - 1:0] DATA = 0, parameter [BYTES - 1:0] PARITY = 0
) (
  input clk_a, clk_b, en_a, en_b, rst_a, rst_b, input [$clog2(8 * BYTES) - 1:0] address_a, address_b,
  input [8 * HALF - 1:0] di_a, di_b, input [HALF - 1:0] dip_a, dip_b, we_a, input [2 * HALF - 1:0] we_b,
  output [8 * HALF - 1:0] do_a, do_b, output [HALF - 1:0] dop_a, dop_b
);
  localparam BOTH = 18 * HALF;
  reg [7:0] data[0:BYTES - 1];
  reg parity[0:BYTES - 1];
  reg [16 * HALF - 1:0] q_a = {INIT_B[8 * HALF - 1:0], INIT_A[8 * HALF - 1:0]};
  reg [2 * HALF - 1:0] p_a = {INIT_B[9 * HALF - 1:8 * HALF], INIT_A[9 * HALF - 1:8 * HALF]};
  reg [8 * HALF - 1:0] q_b = INIT_B[8 * HALF - 1:0];
  reg [HALF - 1:0] p_b = INIT_B[9 * HALF - 1:8 * HALF];
  integer i, j, from_a, from_b, to_a, to_b;

  assign {dop_a, do_a} = {p_a[HALF - 1:0], q_a[8 * HALF - 1:0]};
  assign {dop_b, do_b} = READ_A == BOTH ? {p_a[2 * HALF - 1:HALF], q_a[16 * HALF - 1:8 * HALF]} : {p_b, q_b};

  function supported(input integer width, input both);
    supported = width == 0 || width == 9 || width == 18 || width == 36 && (HALF == 4 || both) || width == 72 && both;
  endfunction

  initial begin
    if (!PLAIN || !supported(READ_A, MODE == "SDP") || !supported(READ_B, 0) || !supported(WRITE_A, 0)
        || !supported(WRITE_B, MODE == "SDP")) begin
      $display("block RAM: no model of these parameters");
      $finish(1);
    end
    for (i = 0; i < BYTES; i = i + 1) begin
      data[i] = DATA[8 * i +: 8];
      parity[i] = PARITY[i];
    end
  end

  // Words begin at multiples of their bytes; writes take place after reads, unless a port reads what it writes.
  always @(posedge clk_a) if (en_a) begin
    from_a = address_a / 8 / (READ_A / 9 + (READ_A == 0)) * (READ_A / 9);
    to_a = address_a / 8 / (WRITE_A / 9 + (WRITE_A == 0)) * (WRITE_A / 9);
    if (rst_a) begin
      q_a <= {SRVAL_B[8 * HALF - 1:0], SRVAL_A[8 * HALF - 1:0]};
      p_a <= {SRVAL_B[9 * HALF - 1:8 * HALF], SRVAL_A[9 * HALF - 1:8 * HALF]};
    end else if (!(WRITE_A > 0 && WRITE_MODE_A == "NO_CHANGE" && |we_a))
      for (i = 0; i < READ_A / 9; i = i + 1)
        if (WRITE_MODE_A == "WRITE_FIRST" && from_a + i >= to_a && from_a + i < to_a + WRITE_A / 9
            && we_a[from_a + i - to_a]) begin
          q_a[8 * i +: 8] <= di_a[8 * (from_a + i - to_a) +: 8];
          p_a[i] <= dip_a[from_a + i - to_a];
        end else begin
          q_a[8 * i +: 8] <= data[from_a + i];
          p_a[i] <= parity[from_a + i];
        end
    for (i = 0; i < WRITE_A / 9; i = i + 1) if (we_a[i]) begin
      data[to_a + i] <= di_a[8 * i +: 8];
      parity[to_a + i] <= dip_a[i];
    end
  end

  wire [16 * HALF - 1:0] written = WRITE_B == BOTH ? {di_b, di_a} : di_b;
  wire [2 * HALF - 1:0] written_parity = WRITE_B == BOTH ? {dip_b, dip_a} : dip_b;

  always @(posedge clk_b) if (en_b) begin
    from_b = address_b / 8 / (READ_B / 9 + (READ_B == 0)) * (READ_B / 9);
    to_b = address_b / 8 / (WRITE_B / 9 + (WRITE_B == 0)) * (WRITE_B / 9);
    if (rst_b) begin
      q_b <= SRVAL_B[8 * HALF - 1:0];
      p_b <= SRVAL_B[9 * HALF - 1:8 * HALF];
    end else if (!(WRITE_B > 0 && WRITE_MODE_B == "NO_CHANGE" && |we_b))
      for (j = 0; j < READ_B / 9; j = j + 1)
        if (WRITE_MODE_B == "WRITE_FIRST" && from_b + j >= to_b && from_b + j < to_b + WRITE_B / 9
            && we_b[from_b + j - to_b]) begin
          q_b[8 * j +: 8] <= di_b[8 * (from_b + j - to_b) +: 8];
          p_b[j] <= dip_b[from_b + j - to_b];
        end else begin
          q_b[8 * j +: 8] <= data[from_b + j];
          p_b[j] <= parity[from_b + j];
        end
    for (j = 0; j < WRITE_B / 9; j = j + 1) if (we_b[j]) begin
      data[to_b + j] <= written[8 * j +: 8];
      parity[to_b + j] <= written_parity[j];
    end
  end
endmodule

module RAMB18E1 (
  input CLKARDCLK, CLKBWRCLK, ENARDEN, ENBWREN, REGCEAREGCE, REGCEB, RSTRAMARSTRAM, RSTRAMB, RSTREGARSTREG, RSTREGB,
  input [13:0] ADDRARDADDR, ADDRBWRADDR,
  input [15:0] DIADI, DIBDI, input [1:0] DIPADIP, DIPBDIP, input [1:0] WEA, input [3:0] WEBWE,
  output [15:0] DOADO, DOBDO, output [1:0] DOPADOP, DOPBDOP
);
  parameter RAM_MODE = "TDP";
  parameter integer READ_WIDTH_A = 0, READ_WIDTH_B = 0, WRITE_WIDTH_A = 0, WRITE_WIDTH_B = 0;
  parameter WRITE_MODE_A = "WRITE_FIRST", WRITE_MODE_B = "WRITE_FIRST";
  parameter integer DOA_REG = 0, DOB_REG = 0;
  parameter RAM_EXTENSION_A = "NONE", RAM_EXTENSION_B = "NONE";
  parameter [17:0] INIT_A = 0, INIT_B = 0, SRVAL_A = 0, SRVAL_B = 0;
  parameter [255:0] INIT_00 = 0, INIT_01 = 0, INIT_02 = 0, INIT_03 = 0;
  parameter [255:0] INIT_04 = 0, INIT_05 = 0, INIT_06 = 0, INIT_07 = 0;
  parameter [255:0] INIT_08 = 0, INIT_09 = 0, INIT_0A = 0, INIT_0B = 0;
  parameter [255:0] INIT_0C = 0, INIT_0D = 0, INIT_0E = 0, INIT_0F = 0;
  parameter [255:0] INIT_10 = 0, INIT_11 = 0, INIT_12 = 0, INIT_13 = 0;
  parameter [255:0] INIT_14 = 0, INIT_15 = 0, INIT_16 = 0, INIT_17 = 0;
  parameter [255:0] INIT_18 = 0, INIT_19 = 0, INIT_1A = 0, INIT_1B = 0;
  parameter [255:0] INIT_1C = 0, INIT_1D = 0, INIT_1E = 0, INIT_1F = 0;
  parameter [255:0] INIT_20 = 0, INIT_21 = 0, INIT_22 = 0, INIT_23 = 0;
  parameter [255:0] INIT_24 = 0, INIT_25 = 0, INIT_26 = 0, INIT_27 = 0;
  parameter [255:0] INIT_28 = 0, INIT_29 = 0, INIT_2A = 0, INIT_2B = 0;
  parameter [255:0] INIT_2C = 0, INIT_2D = 0, INIT_2E = 0, INIT_2F = 0;
  parameter [255:0] INIT_30 = 0, INIT_31 = 0, INIT_32 = 0, INIT_33 = 0;
  parameter [255:0] INIT_34 = 0, INIT_35 = 0, INIT_36 = 0, INIT_37 = 0;
  parameter [255:0] INIT_38 = 0, INIT_39 = 0, INIT_3A = 0, INIT_3B = 0;
  parameter [255:0] INIT_3C = 0, INIT_3D = 0, INIT_3E = 0, INIT_3F = 0;
  parameter [255:0] INITP_00 = 0, INITP_01 = 0, INITP_02 = 0, INITP_03 = 0;
  parameter [255:0] INITP_04 = 0, INITP_05 = 0, INITP_06 = 0, INITP_07 = 0;

  block_ram #(
    .BYTES(2048), .HALF(2), .MODE(RAM_MODE), .WRITE_MODE_A(WRITE_MODE_A), .WRITE_MODE_B(WRITE_MODE_B),
    .READ_A(READ_WIDTH_A), .READ_B(READ_WIDTH_B), .WRITE_A(WRITE_WIDTH_A), .WRITE_B(WRITE_WIDTH_B),
    .PLAIN(DOA_REG == 0 && DOB_REG == 0 && RAM_EXTENSION_A == "NONE" && RAM_EXTENSION_B == "NONE"),
    .INIT_A(INIT_A), .INIT_B(INIT_B), .SRVAL_A(SRVAL_A), .SRVAL_B(SRVAL_B),
    .DATA({
    INIT_3F, INIT_3E, INIT_3D, INIT_3C, INIT_3B, INIT_3A, INIT_39, INIT_38,
    INIT_37, INIT_36, INIT_35, INIT_34, INIT_33, INIT_32, INIT_31, INIT_30,
    INIT_2F, INIT_2E, INIT_2D, INIT_2C, INIT_2B, INIT_2A, INIT_29, INIT_28,
    INIT_27, INIT_26, INIT_25, INIT_24, INIT_23, INIT_22, INIT_21, INIT_20,
    INIT_1F, INIT_1E, INIT_1D, INIT_1C, INIT_1B, INIT_1A, INIT_19, INIT_18,
    INIT_17, INIT_16, INIT_15, INIT_14, INIT_13, INIT_12, INIT_11, INIT_10,
    INIT_0F, INIT_0E, INIT_0D, INIT_0C, INIT_0B, INIT_0A, INIT_09, INIT_08,
    INIT_07, INIT_06, INIT_05, INIT_04, INIT_03, INIT_02, INIT_01, INIT_00
    }),
    .PARITY({
    INITP_07, INITP_06, INITP_05, INITP_04, INITP_03, INITP_02, INITP_01, INITP_00
    })
  ) ram (
    .clk_a(CLKARDCLK), .clk_b(CLKBWRCLK), .en_a(ENARDEN), .en_b(ENBWREN), .rst_a(RSTRAMARSTRAM), .rst_b(RSTRAMB),
    .address_a(ADDRARDADDR[13:0]), .address_b(ADDRBWRADDR[13:0]),
    .di_a(DIADI), .di_b(DIBDI), .dip_a(DIPADIP), .dip_b(DIPBDIP), .we_a(WEA), .we_b(WEBWE),
    .do_a(DOADO), .do_b(DOBDO), .dop_a(DOPADOP), .dop_b(DOPBDOP)
  );
endmodule

module RAMB36E1 (
  input CLKARDCLK, CLKBWRCLK, ENARDEN, ENBWREN, REGCEAREGCE, REGCEB, RSTRAMARSTRAM, RSTRAMB, RSTREGARSTREG, RSTREGB,
  input [15:0] ADDRARDADDR, ADDRBWRADDR,
  input [31:0] DIADI, DIBDI, input [3:0] DIPADIP, DIPBDIP, input [3:0] WEA, input [7:0] WEBWE,
  output [31:0] DOADO, DOBDO, output [3:0] DOPADOP, DOPBDOP
);
  parameter RAM_MODE = "TDP";
  parameter integer READ_WIDTH_A = 0, READ_WIDTH_B = 0, WRITE_WIDTH_A = 0, WRITE_WIDTH_B = 0;
  parameter WRITE_MODE_A = "WRITE_FIRST", WRITE_MODE_B = "WRITE_FIRST";
  parameter integer DOA_REG = 0, DOB_REG = 0;
  parameter RAM_EXTENSION_A = "NONE", RAM_EXTENSION_B = "NONE";
  parameter [35:0] INIT_A = 0, INIT_B = 0, SRVAL_A = 0, SRVAL_B = 0;
  parameter [255:0] INIT_00 = 0, INIT_01 = 0, INIT_02 = 0, INIT_03 = 0;
  parameter [255:0] INIT_04 = 0, INIT_05 = 0, INIT_06 = 0, INIT_07 = 0;
  parameter [255:0] INIT_08 = 0, INIT_09 = 0, INIT_0A = 0, INIT_0B = 0;
  parameter [255:0] INIT_0C = 0, INIT_0D = 0, INIT_0E = 0, INIT_0F = 0;
  parameter [255:0] INIT_10 = 0, INIT_11 = 0, INIT_12 = 0, INIT_13 = 0;
  parameter [255:0] INIT_14 = 0, INIT_15 = 0, INIT_16 = 0, INIT_17 = 0;
  parameter [255:0] INIT_18 = 0, INIT_19 = 0, INIT_1A = 0, INIT_1B = 0;
  parameter [255:0] INIT_1C = 0, INIT_1D = 0, INIT_1E = 0, INIT_1F = 0;
  parameter [255:0] INIT_20 = 0, INIT_21 = 0, INIT_22 = 0, INIT_23 = 0;
  parameter [255:0] INIT_24 = 0, INIT_25 = 0, INIT_26 = 0, INIT_27 = 0;
  parameter [255:0] INIT_28 = 0, INIT_29 = 0, INIT_2A = 0, INIT_2B = 0;
  parameter [255:0] INIT_2C = 0, INIT_2D = 0, INIT_2E = 0, INIT_2F = 0;
  parameter [255:0] INIT_30 = 0, INIT_31 = 0, INIT_32 = 0, INIT_33 = 0;
  parameter [255:0] INIT_34 = 0, INIT_35 = 0, INIT_36 = 0, INIT_37 = 0;
  parameter [255:0] INIT_38 = 0, INIT_39 = 0, INIT_3A = 0, INIT_3B = 0;
  parameter [255:0] INIT_3C = 0, INIT_3D = 0, INIT_3E = 0, INIT_3F = 0;
  parameter [255:0] INIT_40 = 0, INIT_41 = 0, INIT_42 = 0, INIT_43 = 0;
  parameter [255:0] INIT_44 = 0, INIT_45 = 0, INIT_46 = 0, INIT_47 = 0;
  parameter [255:0] INIT_48 = 0, INIT_49 = 0, INIT_4A = 0, INIT_4B = 0;
  parameter [255:0] INIT_4C = 0, INIT_4D = 0, INIT_4E = 0, INIT_4F = 0;
  parameter [255:0] INIT_50 = 0, INIT_51 = 0, INIT_52 = 0, INIT_53 = 0;
  parameter [255:0] INIT_54 = 0, INIT_55 = 0, INIT_56 = 0, INIT_57 = 0;
  parameter [255:0] INIT_58 = 0, INIT_59 = 0, INIT_5A = 0, INIT_5B = 0;
  parameter [255:0] INIT_5C = 0, INIT_5D = 0, INIT_5E = 0, INIT_5F = 0;
  parameter [255:0] INIT_60 = 0, INIT_61 = 0, INIT_62 = 0, INIT_63 = 0;
  parameter [255:0] INIT_64 = 0, INIT_65 = 0, INIT_66 = 0, INIT_67 = 0;
  parameter [255:0] INIT_68 = 0, INIT_69 = 0, INIT_6A = 0, INIT_6B = 0;
  parameter [255:0] INIT_6C = 0, INIT_6D = 0, INIT_6E = 0, INIT_6F = 0;
  parameter [255:0] INIT_70 = 0, INIT_71 = 0, INIT_72 = 0, INIT_73 = 0;
  parameter [255:0] INIT_74 = 0, INIT_75 = 0, INIT_76 = 0, INIT_77 = 0;
  parameter [255:0] INIT_78 = 0, INIT_79 = 0, INIT_7A = 0, INIT_7B = 0;
  parameter [255:0] INIT_7C = 0, INIT_7D = 0, INIT_7E = 0, INIT_7F = 0;
  parameter [255:0] INITP_00 = 0, INITP_01 = 0, INITP_02 = 0, INITP_03 = 0;
  parameter [255:0] INITP_04 = 0, INITP_05 = 0, INITP_06 = 0, INITP_07 = 0;
  parameter [255:0] INITP_08 = 0, INITP_09 = 0, INITP_0A = 0, INITP_0B = 0;
  parameter [255:0] INITP_0C = 0, INITP_0D = 0, INITP_0E = 0, INITP_0F = 0;

  block_ram #(
    .BYTES(4096), .HALF(4), .MODE(RAM_MODE), .WRITE_MODE_A(WRITE_MODE_A), .WRITE_MODE_B(WRITE_MODE_B),
    .READ_A(READ_WIDTH_A), .READ_B(READ_WIDTH_B), .WRITE_A(WRITE_WIDTH_A), .WRITE_B(WRITE_WIDTH_B),
    .PLAIN(DOA_REG == 0 && DOB_REG == 0 && RAM_EXTENSION_A == "NONE" && RAM_EXTENSION_B == "NONE"),
    .INIT_A(INIT_A), .INIT_B(INIT_B), .SRVAL_A(SRVAL_A), .SRVAL_B(SRVAL_B),
    .DATA({
    INIT_7F, INIT_7E, INIT_7D, INIT_7C, INIT_7B, INIT_7A, INIT_79, INIT_78,
    INIT_77, INIT_76, INIT_75, INIT_74, INIT_73, INIT_72, INIT_71, INIT_70,
    INIT_6F, INIT_6E, INIT_6D, INIT_6C, INIT_6B, INIT_6A, INIT_69, INIT_68,
    INIT_67, INIT_66, INIT_65, INIT_64, INIT_63, INIT_62, INIT_61, INIT_60,
    INIT_5F, INIT_5E, INIT_5D, INIT_5C, INIT_5B, INIT_5A, INIT_59, INIT_58,
    INIT_57, INIT_56, INIT_55, INIT_54, INIT_53, INIT_52, INIT_51, INIT_50,
    INIT_4F, INIT_4E, INIT_4D, INIT_4C, INIT_4B, INIT_4A, INIT_49, INIT_48,
    INIT_47, INIT_46, INIT_45, INIT_44, INIT_43, INIT_42, INIT_41, INIT_40,
    INIT_3F, INIT_3E, INIT_3D, INIT_3C, INIT_3B, INIT_3A, INIT_39, INIT_38,
    INIT_37, INIT_36, INIT_35, INIT_34, INIT_33, INIT_32, INIT_31, INIT_30,
    INIT_2F, INIT_2E, INIT_2D, INIT_2C, INIT_2B, INIT_2A, INIT_29, INIT_28,
    INIT_27, INIT_26, INIT_25, INIT_24, INIT_23, INIT_22, INIT_21, INIT_20,
    INIT_1F, INIT_1E, INIT_1D, INIT_1C, INIT_1B, INIT_1A, INIT_19, INIT_18,
    INIT_17, INIT_16, INIT_15, INIT_14, INIT_13, INIT_12, INIT_11, INIT_10,
    INIT_0F, INIT_0E, INIT_0D, INIT_0C, INIT_0B, INIT_0A, INIT_09, INIT_08,
    INIT_07, INIT_06, INIT_05, INIT_04, INIT_03, INIT_02, INIT_01, INIT_00
    }),
    .PARITY({
    INITP_0F, INITP_0E, INITP_0D, INITP_0C, INITP_0B, INITP_0A, INITP_09, INITP_08,
    INITP_07, INITP_06, INITP_05, INITP_04, INITP_03, INITP_02, INITP_01, INITP_00
    })
  ) ram (
    .clk_a(CLKARDCLK), .clk_b(CLKBWRCLK), .en_a(ENARDEN), .en_b(ENBWREN), .rst_a(RSTRAMARSTRAM), .rst_b(RSTRAMB),
    .address_a(ADDRARDADDR[14:0]), .address_b(ADDRBWRADDR[14:0]),
    .di_a(DIADI), .di_b(DIBDI), .dip_a(DIPADIP), .dip_b(DIPBDIP), .we_a(WEA), .we_b(WEBWE),
    .do_a(DOADO), .do_b(DOBDO), .dop_a(DOPADOP), .dop_b(DOPBDOP)
  );
endmodule
